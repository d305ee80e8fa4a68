"""The commands, a module each."""

from g1_description.threads import one_thread

# Before anything imports numpy, which reads this once: for arrays of a robot's size,
# threads would spend their time waiting for each other.
one_thread()
