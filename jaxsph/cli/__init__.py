"""The command line: the `jaxsph` command, and a file for each subject of its commands."""
