"""What the rostests share: processes, listeners, raw sockets and robots."""
