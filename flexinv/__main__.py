"""``python -m flexinv``: the command line where the console script is not on the path."""

from flexinv.cli.commands import main

if __name__ == "__main__":
    main()
