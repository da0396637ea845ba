"""Making a learned shape model: dataset, network, losses, training, export, evaluation."""
