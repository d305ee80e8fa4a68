"""What many verdicts are told in: tables, JSON, CSV and a page."""
