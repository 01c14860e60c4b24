"""The shadow of the Earth: sunlight behind it, refracted and dimmed by its air, on the moon and on satellites."""
