; nothing but a remark
