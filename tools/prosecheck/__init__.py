"""The parts of tools/prose.py: passages of each kind of file, and the rules."""
