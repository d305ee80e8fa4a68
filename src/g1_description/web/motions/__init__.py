"""Motions on a page: their time line, and what checks found along it."""
