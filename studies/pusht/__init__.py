"""PushT under the rules of gym-pusht, with vibgym's contact kernels: ``python -m studies.pusht``, see docs/pusht.md."""
