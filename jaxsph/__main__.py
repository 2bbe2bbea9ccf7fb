"""`python -m jaxsph`: the command line."""

import sys

from jaxsph.cli import main

if __name__ == "__main__":
    sys.exit(main())
