"""Where `swarm-ctl` begins: from here on Ctrl-C ends it in one line, whatever it still imports."""

from __future__ import annotations

import sys

from swarm_ctl.signals import ENDED_CODE, ended, ended_in_one_line, is_ended


def main() -> None:
    """The command line."""
    ended_in_one_line()
    try:
        from swarm_ctl.cli.app import main as command

        command()
    except (Exception, SystemExit):
        if is_ended():  # a library may have made an error of our exception, while imported too
            sys.exit(ENDED_CODE)
        raise
    finally:
        ended()


if __name__ == "__main__":
    main()
