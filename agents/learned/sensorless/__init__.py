"""Search for sensorless schedules, and their judgement: ``python -m agents.learned.sensorless CONFIG``."""
