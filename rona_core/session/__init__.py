"""The session document, its codec and its file."""
