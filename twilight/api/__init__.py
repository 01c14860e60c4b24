"""What `import twilight` offers; `representation` attaches the methods of `Sky` that draw."""

import twilight.api.representation  # noqa: F401 - attaches what draws and stores skies
