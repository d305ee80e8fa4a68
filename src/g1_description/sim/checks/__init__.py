"""All checks of a robot together, on its shapes."""
