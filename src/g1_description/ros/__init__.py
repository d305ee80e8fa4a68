"""Common parts of all nodes: parameters, log, publishers, messages and bytes."""
