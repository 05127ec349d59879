"""A system before it runs: components, connections, groups, and the order that follows from them."""
