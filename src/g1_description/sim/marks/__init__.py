"""What is drawn beside a robot to show what checks found, whoever draws it."""
