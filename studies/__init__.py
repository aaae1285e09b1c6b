"""The laboratory: measures, proves and replicates; nobody needs it to use vibgym."""
