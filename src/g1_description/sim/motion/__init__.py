"""Motions that models go through, step by step."""
