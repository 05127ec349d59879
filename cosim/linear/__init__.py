"""Linear models of systems and their components, and the stability of the coupling of a group."""
