"""Search for sensorless schedules, and their judgement: ``python -m agents.training.sensorless CONFIG``."""
