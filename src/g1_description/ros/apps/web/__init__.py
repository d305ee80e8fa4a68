"""The command ``web``: robots and motions of files in a browser."""
