"""The limb from above the air: sunlight scattered along lines of sight that miss the ground, and the sun behind it."""
