"""How a command is declared and run: options, help, progress, log, messages, exit codes."""
