"""The command check: motions in files, and reports of what is wrong with them."""
