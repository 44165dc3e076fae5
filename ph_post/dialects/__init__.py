"""Controller dialects: one module or folder each, their common contract, and the registry."""
