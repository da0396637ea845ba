"""The tdcr command, one file a subcommand."""
