"""The pipeline's stages: the only code that knows paths, params and DVC."""
