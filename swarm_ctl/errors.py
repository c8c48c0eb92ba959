"""One error tree. The type names the cause: the input, the machine, a message, a link. The text
says what is wrong, where, and what would be allowed."""

from __future__ import annotations

from dataclasses import dataclass


class SwarmError(Exception):
    """Base of all errors that this project raises on purpose. A command that ends by one exits
    with its `exit_code`."""

    exit_code = 1


@dataclass(frozen=True, slots=True)
class Problem:
    """One mistake in an input: where it stands, what is wrong, what would be allowed."""

    where: str
    """`file:line` (or only the file where no line applies)."""
    field: str
    """Dotted path of the field, e.g. `law.r_in`, `step 2, form.shape` or `fleet.agents#3.sysid`."""
    what: str
    allowed: str

    def __str__(self) -> str:
        return f"{self.where}: {self.field}: {self.what}; allowed: {self.allowed}"


class InputError(SwarmError):
    """An input that cannot be used (a file, an argument). Nothing was started."""

    exit_code = 2


class UnknownAgentError(InputError, KeyError):
    """No agent has this id; a `KeyError`, too, as of a mapping of agents by id."""

    def __str__(self) -> str:  # a KeyError's has quotes
        return str(self.args[0]) if self.args else ""


class MissionError(InputError):
    """A mission or fleet file that was refused, with every mistake that was found."""

    def __init__(self, problems: tuple[Problem, ...]) -> None:
        super().__init__("\n".join(str(problem) for problem in problems))
        self.problems = problems


class TrustError(InputError):
    """Keys, certificates or a roster that can't be used: missing, damaged, readable by others, of
    another swarm, revoked."""


class StartError(SwarmError):
    """Something did not start: a busy port, a missing program, a process that died early."""

    exit_code = 3


class PayloadError(SwarmError):
    """Bytes from the mesh that are no known payload (wrong size, version or field). The receiver
    counts and drops them."""


class LinkError(SwarmError):
    """A vehicle link that cannot be opened, or that was closed."""

    exit_code = 3
