"""Learning from a data set alone: cloning and implicit Q-learning."""
