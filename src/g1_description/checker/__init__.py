"""The node checker: services, and checks of the current state."""

from g1_description.threads import one_thread

# Before numpy is imported, which reads this once: threads slow down small arrays.
one_thread()
