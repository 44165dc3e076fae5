"""A dialect, an effect and a strategy of somebody else, made by the recipes of CONTRIBUTING.md."""
