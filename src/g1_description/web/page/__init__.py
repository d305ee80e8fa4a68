"""The page: its panels, and what happens when a person uses them."""
