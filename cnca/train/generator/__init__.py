"""Training of the shipped texture generator: corpus, autoencoder, denoiser."""
