"""Search and evaluation of sensorless schedules: ``python -m studies.sensorless CONFIG``."""
