"""Two audits of the same loops, before and after: what improved, what got worse, by how much. Facts in, facts out."""
