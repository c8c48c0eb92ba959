"""Where `swarm-ctl` begins: from here on Ctrl-C ends it in one line, whatever it still imports."""

from __future__ import annotations

from swarm_ctl.signals import ended, ended_in_one_line


def main() -> None:
    """The command line."""
    ended_in_one_line()
    from swarm_ctl.cli.app import main as command

    try:
        command()
    finally:
        ended()


if __name__ == "__main__":
    main()
