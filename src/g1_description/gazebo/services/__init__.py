"""The services of /gazebo, by subject.

Services that change the world run in the simulator's loop, between two steps; the
others (get_*) run outside of the loop, while nothing changes.
"""
