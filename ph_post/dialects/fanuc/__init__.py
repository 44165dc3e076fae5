"""Fanuc 30i, 31i, 32i and 0i for mills: dialect and reader."""
