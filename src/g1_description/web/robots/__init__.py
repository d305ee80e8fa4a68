"""What a page is told of robots, and what it may ask of them."""
