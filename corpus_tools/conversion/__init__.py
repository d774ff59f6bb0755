"""From recordings, labels and sound to a corpus."""
