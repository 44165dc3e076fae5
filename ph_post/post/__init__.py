"""Turn a plan into blocks and lines of a part program."""
