"""The command that walks from the master to the picture and names the broken link."""
