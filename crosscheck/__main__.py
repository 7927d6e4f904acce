"""``python -m crosscheck``: the command line where the console script is not on the path."""

from crosscheck.start import main

if __name__ == "__main__":
    main()
