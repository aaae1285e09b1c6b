"""Measurements that are run by hand: accuracy and speed."""
