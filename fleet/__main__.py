"""``python -m fleet``: all commands."""

from fleet.terminal.console import own_output

if __name__ == "__main__":
    own_output()
    from fleet.cli.main import main

    main()
