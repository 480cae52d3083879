"""The labelled cube of results: assembled, written, read, described, merged, exported."""
