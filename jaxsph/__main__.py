"""Entry point of the command line; it sets the handler for Ctrl-C before the slow imports begin."""

import gc
import os
import sys

from jaxsph.run import interrupt


def main() -> None:
    """Runs the `jaxsph` command and ends the program with its exit status."""
    interrupt.end_early()
    interrupt.end_with_parent()

    gc.disable()  # the imports make no garbage, and looking for it takes a tenth of their time
    from jaxsph.cli.app import app
    from jaxsph.run.lowered import store_programs

    gc.freeze()
    gc.enable()
    store_programs()

    status: object = 0
    try:
        app()
    except SystemExit as end:
        status = end.code
    except KeyboardInterrupt:
        print("jaxsph: interrupted", file=sys.stderr)
        status = interrupt.CODE
    sys.stdout.flush()
    sys.stderr.flush()
    if status == interrupt.CODE:
        os._exit(interrupt.CODE)  # skips the interpreter's shutdown, where running JAX work could crash
    sys.exit(status)


if __name__ == "__main__":
    main()
