"""How the loops run: samples in, records out.

Layers, each importing only what stands before it: ``samples, loops, records, wire`` (the contract);
``order, detect, identify, assess, advise, engine`` (pure: no clock, no file, no socket);
``config, service, audit, cli`` (the drivers); ``adapters`` (one outside library each).
"""
