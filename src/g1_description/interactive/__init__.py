"""The node interactive: markers in RViz that the whole body follows."""

from g1_description.threads import one_thread

# Before numpy is imported, which reads this once: threads slow down small arrays.
one_thread()
