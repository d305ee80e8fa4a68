"""Pictures of what checks measured."""
