"""Random and hostile requests, files and worlds for the live stand-in."""
