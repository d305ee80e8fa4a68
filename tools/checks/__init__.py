"""All checks and tests of the package, run and counted; tools/test starts it."""
