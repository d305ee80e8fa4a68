"""The node link_states_bridge."""
