"""What tools/benchmark measures, a module per part."""

from g1_description.threads import one_thread

# As the commands do: processor time of threads that wait would count.
one_thread()
