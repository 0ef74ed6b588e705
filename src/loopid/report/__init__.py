"""What people and machines read: one module for each command, imported by its own name."""
