"""A system before it runs: members, connections, groups, and the order that follows from them."""
