"""The air of a place and date: what files of measurements and analyses hold, joined into one profile."""
