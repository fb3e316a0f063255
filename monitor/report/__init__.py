"""One self-contained page of an audit: facts in, HTML out. Nothing is found out here."""
