"""The command line: options, one line for each error, exit codes."""
