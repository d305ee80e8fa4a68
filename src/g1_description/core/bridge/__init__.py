"""What the bridge computes: joint positions from link poses, stamps, commands."""
