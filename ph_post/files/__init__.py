"""Files in and out: paths, machine files, logs, tables and drawings as values; no machine model."""
