"""Photographs against computed skies, and the air that they tell.

Five records, each in the file that says what is inside:

    Photograph (`picture`)      pixels, camera, time, place and sun: what a file holds and says
    PhotoSky (`picture_sky`)    its sky: fine cells of colour, the mask, and cells by elevation and azimuth from the sun
    Skies (`air`)               of an air, between the airs that were computed
    AirEstimate (`intervals`)   the air that fits, its values and intervals
    Estimate (`report`)         sentences, climate, comparison with the photographs

`series` goes from the first to the last, as `options` say; `mask` and `sun_azimuth` make the second of the first, `fit`
and `estimate` the fourth of the others, `comparison` and `figure` show them.
"""
