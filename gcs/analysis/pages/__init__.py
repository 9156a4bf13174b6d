"""What was found, drawn: pictures for `--plot`, and the report as one page."""
