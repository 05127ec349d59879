"""Published figures of merit of vehicles."""
