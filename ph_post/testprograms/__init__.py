"""Test programs that make the effects of a machine visible in a log, and the recording plan for them."""
