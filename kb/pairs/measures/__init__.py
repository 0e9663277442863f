"""What samples say of how good the pairs are: pairs/measures.json, a section for each measure."""
