"""What several components, and those who judge them, have in common."""
