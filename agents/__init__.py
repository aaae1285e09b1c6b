"""Controllers and learners for vibgym, their training and their comparison. Runs from the checkout, not installed."""
