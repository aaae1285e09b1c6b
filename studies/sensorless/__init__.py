"""Search for sensorless schedules, and their judgement: ``python -m studies.sensorless CONFIG``."""
