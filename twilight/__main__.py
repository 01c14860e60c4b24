"""`python -m twilight`: the command line."""

from twilight.cli import main

if __name__ == "__main__":
    main()
