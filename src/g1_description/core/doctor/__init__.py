"""What may be broken between the master and the picture, and how it is recognised."""
