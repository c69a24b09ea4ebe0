"""What a camouflage is worth: AP, verdicts, intervals, candidates and controls."""
