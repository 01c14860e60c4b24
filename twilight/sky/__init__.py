"""What is made of radiance: the sky, its colour, the sun's disc, the stars, the night, tones of pictures."""
