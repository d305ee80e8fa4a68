"""A page with all outcomes, which needs no other file and no network."""
from __future__ import annotations
def write_page(*a): raise NotImplementedError
