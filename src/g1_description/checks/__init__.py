"""Checks of motions and configurations: thresholds, verdicts, reports, batches."""
