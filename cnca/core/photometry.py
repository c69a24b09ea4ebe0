"""Light as eyes count it and as the renderer does."""

CANDELAS = 683.0 * 106.857
"""cd/m² of a spectral radiance of 1 W/m²/nm/sr: 683 lm/W times the integral of V(λ) in nm (CIE)."""
