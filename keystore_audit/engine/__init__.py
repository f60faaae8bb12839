"""Two engines that answer the properties: native Python and the Alloy Analyzer."""
