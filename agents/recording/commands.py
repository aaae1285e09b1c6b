"""``python -m agents record CONFIG``."""

from __future__ import annotations

import argparse

from agents import command_line
from agents.command_line import Command
from vibgym import checks


def record_arguments(parser: argparse.ArgumentParser) -> None:
    """What ``record`` takes."""
    command_line.config(parser, "YAML file, see configs/recordings/")


def record(arguments: argparse.Namespace) -> None:
    """Keep a policy's episodes."""
    from agents.recording.record import record
    from agents.recording.record_settings import load_settings

    settings = load_settings(arguments.config)
    if arguments.output is not None:
        settings = settings.model_copy(update={"directory": str(arguments.output)})
    with checks.within(arguments.config, kind=checks.Refused):
        place, steps, seconds = record(settings, arguments.quiet)
    print(f"{place}: {settings.episodes} episodes, {steps} steps in {seconds:.1f} s, {steps / seconds:.0f} steps/s")


COMMANDS = {"record": Command(record_arguments, record, "directory of data sets, instead of the file's")}
