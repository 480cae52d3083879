"""The labelled cube of results: its variables, how it is assembled, written and described."""
