"""The report of an evaluation: every policy on every task and hardware, effects, cost, films."""
