"""Command line: the `jaxsph` command, and one module for each group of its subcommands."""
