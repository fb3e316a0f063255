"""What several tests share: where things lie, waiting, plants, buses, naive twins."""
