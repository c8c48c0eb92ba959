"""One error tree. The type says who is to blame; the text says what, where and what would be
allowed."""

from __future__ import annotations

from dataclasses import dataclass


class SwarmError(Exception):
    """Base of all errors this project raises on purpose.

    `exit_code` is what a command line ends with when the error reaches it.
    """

    exit_code = 1


@dataclass(frozen=True, slots=True)
class Problem:
    """One mistake in an input: where it stands, what is wrong, what would be allowed."""

    where: str
    """`file:line` (or only the file where no line applies)."""
    field: str
    """Dotted path of the field, e.g. `law.r_in` or `fleet.agents[2].sysid`."""
    what: str
    allowed: str

    def __str__(self) -> str:
        return f"{self.where}: {self.field}: {self.what}; allowed: {self.allowed}"


class InputError(SwarmError):
    """Somebody gave us something that can't be used (a file, an argument). Nothing was started."""

    exit_code = 2


class MissionError(InputError):
    """A mission or fleet file was refused; `problems` holds every mistake found, not only the
    first."""

    def __init__(self, problems: tuple[Problem, ...]) -> None:
        super().__init__("\n".join(str(problem) for problem in problems))
        self.problems = problems


class StartError(SwarmError):
    """The machine did not let us start: a busy port, a missing program, a process that died while
    starting."""

    exit_code = 3


class PayloadError(SwarmError):
    """Bytes from the mesh that are not a payload we know (wrong size, version or field). Counted,
    dropped."""


class LinkError(SwarmError):
    """A vehicle's link can't be opened or was closed under us."""

    exit_code = 3
