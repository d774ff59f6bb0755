"""The talking head: text, phones or tracks in; movies, frames or other programs' files out."""
