"""A joint term that loopid does not have: friction that grows with the square of the speed."""
