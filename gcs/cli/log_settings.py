"""How each of many logs is fitted: the options of commands that fit logs one by one."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from gcs.cli.options import add_band_option, add_effects_option, parse_band, parse_words

if TYPE_CHECKING:
    from gcs.campaign.work import Settings


def add_settings_options(parser: argparse.ArgumentParser) -> None:
    """--model, --with, --band and --profile."""
    parser.add_argument(
        "--model", metavar="BASE", help="the structure to fit (default: tpp or multirotor, as logs tell)"
    )
    add_effects_option(parser, "physical effects to add to each fit, as of `tippath fit`")
    add_band_option(parser)
    parser.add_argument("--profile", metavar="FILE.toml", help="which fields of the logs are which channels")


def parse_settings(args: argparse.Namespace, *, diagnose: bool = False) -> Settings:
    """What is asked of every log; own files by their full paths, for workers elsewhere. Raises UsageError."""
    from gcs.campaign.work import Settings
    from gcs.cli.fit import parse_base, parse_effects
    from gcs.logs.profile.profiles import load
    from sysid.model.base import find_base

    words = parse_words(args.effects)
    base = find_base("tpp") if args.model is None else parse_base(args.model)
    parse_effects(base, words, {})
    if args.profile is not None:
        load(Path(args.profile))
    return Settings(
        model=None if args.model is None else _full(args.model),
        effects=tuple(_full(word) for word in words),
        band_hz=None if args.band is None else parse_band(args.band),
        profile=None if args.profile is None else _full(args.profile),
        diagnose=diagnose,
    )


def _full(word: str) -> str:
    return str(Path(word).absolute()) if Path(word).is_file() else word
