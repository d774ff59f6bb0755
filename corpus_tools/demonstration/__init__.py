"""The demo: the complete path on recordings that it makes itself."""
