"""Measures speed and memory of the installed command; each module is a program."""
