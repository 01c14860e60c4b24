"""What `import twilight` offers.  Every way to a `Sky` leads through this room, whose `representation` draws it."""

import twilight.api.representation  # noqa: F401 - attaches what draws and stores skies
