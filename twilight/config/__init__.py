"""Climates and configurations: YAML documents, their models, and the ones that come with the program."""

from twilight.config.climate import Climate
from twilight.config.load import Case, load, load_climate, load_series
from twilight.config.scene import Config

__all__ = ["Case", "Climate", "Config", "load", "load_climate", "load_series"]
