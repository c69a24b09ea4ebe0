"""Training of detectors: pictures with boxes, losses by kind of head, accuracy by kind of paint."""
