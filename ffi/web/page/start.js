// Modules are not loaded from files: this classic script can say so.
if (location.protocol === 'file:') document.getElementById('needs-server').hidden = false;
